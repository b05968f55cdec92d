"""What predicts?

    m4gn       the network of the paper, in reading order
    sections   a small one for beams, each section by itself
    shapes     a small one for bodies of any shape, each pose by itself
    stored     weights and a header on disk
"""
