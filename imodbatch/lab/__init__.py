"""Datasets made from nothing: scenes whose truth is known exactly."""
