"""The fit of a box's score: candidates, logistic regression, report."""
