"""What is done for a cell: the stages of the method, and experiments of another kind."""
