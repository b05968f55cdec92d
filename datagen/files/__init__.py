"""One trajectory on disk.

    trajectory   its format: write, read, check
    layout       whether arrays have the shapes of the format
    places       what is kept of a mesh file
    solved       the scene and the mesh that it is a solution of
    fields       what a file can hold besides displacements: stress
    tfrecord     records of TensorFlow, byte by byte
    inputs       what a predictor may see of one, as arrays
    prediction   a file, or a folder of them, compared with true ones
    provenance   which program, libraries and machine a number comes from
"""
