"""What predicts?

    m4gn       the network of the paper, in reading order
    sections   a small one for beams, each section by itself
    stored     weights and a header on disk
"""
