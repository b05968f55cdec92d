"""What is measured of predictors, and how is it shown?

    measure       every predictor on every case, by physics/fidelity, where the figures are worked out
    table         columns, units and rows
    pareto        speed against error, as a picture
    cost          what a training has cost, and after how many scenes that is paid back
    report        report.html and report.json
    shown         which trajectory and which frames the page shows
    differences   of trained runs, and their spread
    evaluate      a trained run beside its rivals
    compare       all rivals on one scene or set
"""
