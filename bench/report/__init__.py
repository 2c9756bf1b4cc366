"""Building blocks of all reports: wording, tables for terminal and Markdown, plots, and self-contained pages."""
