"""The two engines that carry a model through time, what they share, and the door to them (`schemes`)."""
