"""Many trainings that differ in one thing, and a table of what came of them. The studies themselves are files in learning/studies/.

    plan    what a study file asks for at a size: rows, configs, data
    work    one training, and what is measured of it
    run     all of them, stopped and resumed
    table   means, deviations, and which rows can be told apart; table.md and table.csv
    page    report.html with the curves
"""
