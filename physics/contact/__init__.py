"""Where are the obstacles, and what do they do to the body?

    obstacles    an obstacle on its path, several felt as one, and the list of shapes
    shapes       a class for each shape: distance, normal, curvature, extents
    tool         any closed surface of triangles, its distance made smooth
    closed       the exact distance to such a surface
    surfaces     the surfaces of obstacles as meshes
    points       where on the body's surface contact is felt
    rounded      this surface without the edges between its facets
    conditions   the contact condition gap >= 0, p >= 0, p gap = 0, at points of the body's surface
    touch        contact condensed to the nodes near an obstacle (Schur complement)
"""
