"""What predicts?

    m4gn   the network of the paper, in reading order
"""
