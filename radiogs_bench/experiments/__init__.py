"""What is done for a cell: training and scoring, and experiments that train nothing."""
