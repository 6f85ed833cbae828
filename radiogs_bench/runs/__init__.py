"""From a suite to stored cells: cells and their keys, sweeps, stages of training, experiments, engines."""
