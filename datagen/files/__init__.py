"""One trajectory on disk.

    trajectory   its format: write, read, check
    fields       what a file can hold of a solution besides its displacements: stress
    tfrecord     records of TensorFlow, byte by byte
    prediction   a file held against a true one
    provenance   which program, libraries and machine a number comes from
"""
