"""How are weights found, stopped and gone on with?

    curve       the record of a training as it goes
    run         a training between two steps: begun, resumed, stored
    walks       frames that the network's own predictions have led to (pushforward training)
    train       the loop
    poses       the loop of predictors that know all poses of a path at once
    sections    what a predictor of beams learns from
    shapes      what a predictor of bodies by shapes learns from
    calibrate   error bars of a trained one, from other trajectories
    kinds       which of these loops a config asks for
"""
