"""What depth sensors do to a picture: one small function a model, and the mixtures that training and benchmarks see."""
