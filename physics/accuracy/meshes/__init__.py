"""The meshes that a body may have when an error is asked for.

    ladder  from coarse to fine along each direction, and the points at which they are compared
    drawn   those of a drawing, with small cells where the solution on the mesh before asks for them
"""
