"""How are weights found, stopped and gone on with?

    processes   several processes on one training
    curve       what a training says of itself as it goes
    run         a training between two steps: begun, resumed, kept
    train       the loop
    sections    the loop of a predictor of beams
    kinds       whichever a config asks for
"""
