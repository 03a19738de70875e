"""Robots on a network: what they tell each other in bytes, what each holds of the others, and the radio in between."""
