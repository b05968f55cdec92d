"""Flows in place of solids.

    trajectory   the file of one
    check        one held against its scene
    figures      one in numbers
    refined      one held against the same on finer cells
    prediction   a prediction held against one
    verb         what simulate does with one
"""
