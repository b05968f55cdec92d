"""A folder of trajectories.

    dataset      its manifest
    plan         what it will be like, before anything is solved
    workers      processes of this machine or of a Dask cluster
    generate     made, or gone on with
    check        held against the scenes it is of
    statistics   its figures
    card         its data card
    pack         made small, to a stated tolerance
    deepmind     exchanged as DeepMind's records
"""
