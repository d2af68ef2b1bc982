"""Campaigns against damaged input (`make fuzz`) and against killed processes (`make kill`)."""
