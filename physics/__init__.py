"""Finite elements: scenes, elastic modes, quasi-static contact, mesh quality, and predictions held against all of it."""
