"""What predicts?

    blocks     what networks are made of
    m4gn       the network of the paper, in reading order
    rivals/    what it is compared with, each in a file
    kinds      every kind by its name: a new network is listed here
    sections   a small one for beams, each section by itself
    shapes     a small one for bodies of any shape, each pose by itself
    stored     weights and a header on disk
"""
