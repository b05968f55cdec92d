"""Flows: what a learned simulator of them has to beat, and all predictors compared.

    rivals        trivial predictors, and the same solver on larger cells
    divergence    a network's frames made free of divergence
    report        the page, the picture and the film
    compare       all predictors measured on the same flows
"""
