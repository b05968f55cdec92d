"""What predicts?

    blocks     what networks are made of
    m4gn       the network of the paper, in reading order
    rivals/    what it is held against, each in a file
    kinds      whichever a config asks for
    sections   a small one for beams, each section by itself
    shapes     a small one for bodies of any shape, each pose by itself
    stored     weights and a header on disk
"""
