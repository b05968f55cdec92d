"""In which order are the unknowns of a stiffness eliminated? Of coordinates and cells alone, and in numpy alone.

    nested   nested dissection: the least fill of large bodies
"""
