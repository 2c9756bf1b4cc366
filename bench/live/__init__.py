"""A compensator on a stage while one watches: the loop in a process of its own, and beside it, in another one, its
watchdog, its recording and its page."""
