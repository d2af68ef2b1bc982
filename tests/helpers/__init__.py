"""Inputs, references and small networks that tests share."""
