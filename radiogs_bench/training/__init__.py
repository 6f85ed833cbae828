"""Runs the stages of a method: checkpoints, ledgers, progress, interruption."""
