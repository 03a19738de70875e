"""What came of the experiment: tables beside the paper's, curves, claims, figures, and a page."""
