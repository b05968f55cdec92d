"""Flows: what a learned simulator of them has to beat, and all of them beside each other.

    rivals        predictors that know nothing, and the same solver on larger cells
    divergence    a network's frames made free of it
    report        the page, the picture and the film
    compare       everything that predicts, measured on the same flows
"""
