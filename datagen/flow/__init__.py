"""Flows in place of solids.

    trajectory   the file of one
    check        one held against its scene
    figures      one in numbers
    verb         what simulate does with one
"""
