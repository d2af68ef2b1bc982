"""Rows of Tables III and IV: training and evaluation, stored outputs, table."""
