"""A compensator on a running stage: the loop in one process, and its watchdog, recorder and page in another."""
