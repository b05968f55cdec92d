"""A folder of trajectories.

    dataset      its manifest
    plan         what it will be like, before anything is solved
    workers      processes of this machine or of a Dask cluster
    generate     a set made, or resumed
    check        a set compared with its scenes
    statistics   its figures
    card         its data card
    pack         a set made small, to a stated tolerance
    deepmind     a set exchanged as DeepMind's records
"""
