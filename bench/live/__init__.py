"""A compensator on a stage while one watches: the loop, its recording, its watchdog and its page, each in a process of
its own."""
