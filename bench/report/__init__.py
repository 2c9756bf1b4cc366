"""What all reports are made of: words and tables for the terminal and Markdown, plots, and pages that stand alone."""
