"""Running the stages of a method to their end: checkpoints, ledgers, progress, interruption."""
