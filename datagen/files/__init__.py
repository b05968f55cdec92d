"""One trajectory on disk.

    trajectory   its format: write, read, check
    layout       whether arrays have the shapes of the format
    places       what is kept of a mesh file
    tfrecord     records of TensorFlow, byte by byte
    prediction   a file held against a true one
    provenance   which program, libraries and machine a number comes from
"""
