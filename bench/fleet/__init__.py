"""Batch processing of many recordings: the same work on each, on several workers, resumable, with one table."""
