"""Many recordings at once: the same work on each, on several workers, resumable, with one table and one page for
all."""
