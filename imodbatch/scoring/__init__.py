"""Boxes held against the truth: matches, metrics, and what holds fusion back."""
