"""Published figures, readers of public codes' output folders, and baseline methods."""
