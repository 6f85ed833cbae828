"""What stored results say: the summary that reports are made from, the tables of the paper, the gate."""
