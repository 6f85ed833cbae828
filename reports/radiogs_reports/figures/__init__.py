"""Figures for papers and talks, as PNG and as PDF: a file per figure."""
