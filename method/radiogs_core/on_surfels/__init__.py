"""The parts that methods on surfels share: stage 1, the loop of a stage, initial materials, and a trained model."""
