"""The meshes of shapes that a scene describes by a few numbers.

    boxes      beams along x, and plates
    channel    a channel with a round hole
    graded     the same in triangles that grow away from it
    panel      a flat panel of any outline with round holes, in layers of tetrahedra
"""
