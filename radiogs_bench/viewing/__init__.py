"""Pictures of a trained model from all around."""
