"""What depth sensors do to depth images and clouds: one small function for each model, with its source."""
