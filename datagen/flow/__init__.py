"""Flows in place of solids.

    trajectory   the file of a flow
    check        a flow compared with its scene
    figures      its figures
    refined      a flow compared with the same on finer cells
    prediction   a prediction compared with a true flow
    verb         what `simulate` does with a flow
"""
