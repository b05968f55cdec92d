"""Flows in place of solids.

    trajectory   the file of one
    verb         what simulate does with one
"""
