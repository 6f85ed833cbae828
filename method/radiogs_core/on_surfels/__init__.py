"""What methods on surfels share: stage 1, the loop of a stage, what materials start as, and a trained model."""
