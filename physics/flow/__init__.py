"""How does a fluid flow through a plane domain? Incompressible, Newtonian, laminar.

    space        Taylor-Hood spaces on straight and curved triangles, and their sums over cells (loops.cpp)
    planar       Cholesky factors of one unknown a node (planar.cpp)
    conditions   what is given at the boundary, and what happens where fluid leaves
    stepping     one step in time, split, with kept factors
    forces       drag and lift from the residual, a difference of pressure
    frames       how long a step is, and what is reported of each frame
    stationary   the stationary flow, by Newton's method
    stored       the mesh on which frames are stored
    solution     `solve_flow`: the answer to a scene
"""
