"""May a mesh be believed?

    cells    each cell by itself: listed twice, corners named twice, crossed, inside out, without volume
    fit      how they fit together: faces of three cells, overlaps, nodes on sides of other cells, pieces
    curved   cells of second order: where their middle nodes lie, and what they make of the cells
    rows     sides and edges as rows of node numbers: which are alike
    folded   a deformed body that passes through itself
"""
