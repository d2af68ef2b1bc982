"""One file per table or figure of the paper, the demo, and checks of networks and baselines."""
