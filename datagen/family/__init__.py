"""What scenes are drawn?

    family   a scene file with ranges, and its reproducible draws
    place    where an obstacle goes: along the body, so far off, so deep
    vary     one body under many obstacles
"""
