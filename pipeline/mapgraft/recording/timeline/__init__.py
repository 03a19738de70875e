"""From messages to observations: one pass in order of time, and the tally of what became of each."""
