"""Graph superpixels as learning/segments/cut.py defines them, in plain loops: for tests."""

TIE = 1e-5  # [segment sizes] distances this close are equal


def distance(row, other, tau):
    """|f_obs - f_obs'| + |f_md - f_md'| + tau |x - x'| of two rows."""
    gap = [a - b for a, b in zip(row, other, strict=True)]
    return abs(gap[0]) + sum(g * g for g in gap[1:-3]) ** 0.5 + tau * sum(g * g for g in gap[-3:]) ** 0.5


def centroids(label, table):
    """The mean row of each segment."""
    found = []
    for k in range(max(label) + 1):
        rows = [table[i] for i in range(len(label)) if label[i] == k]
        found.append([sum(column) / len(rows) for column in zip(*rows, strict=True)])
    return found


def nearest(way):
    """Of names and distances {name: d} the lowest name among those as near as the nearest."""
    return min(name for name in way if way[name] <= min(way.values()) + TIE)


def pieces(label, beside):
    """The connected pieces of all segments, as lists of nodes, by their lowest node; beside[i]: the neighbours of node i."""
    found, seen = [], set()
    for start in range(len(label)):
        if start in seen:
            continue
        piece, front = {start}, [start]
        while front:
            front = [j for i in front for j in beside[i] if label[j] == label[i] and j not in piece and not piece.add(j)]
        seen |= piece
        found.append(sorted(piece))
    return found


def sweep(label, beside, table, tau):
    """Every node at a border goes to the nearest segment that it touches, but for the one nearest to the centroid of each."""
    centre = centroids(label, table)
    own = [distance(table[i], centre[label[i]], tau) for i in range(len(label))]
    moved = list(label)
    for i in range(len(label)):
        way = {label[j]: distance(table[i], centre[label[j]], tau) for j in beside[i] if label[j] != label[i]}
        if way and min(way.values()) < own[i] - TIE:
            moved[i] = nearest(way)
    for k in range(max(label) + 1):
        keep = nearest({i: own[i] for i in range(len(label)) if label[i] == k})
        moved[keep] = k
    return moved


def reattach(label, beside, table, tau):
    """Each segment keeps its largest piece; nodes of the others go to the nearest segment around them, layer by layer."""
    centre, label = centroids(label, table), list(label)
    kept = {}
    for piece in pieces(label, beside):
        if len(piece) > len(kept.get(label[piece[0]], [])):
            kept[label[piece[0]]] = piece
    loose = set(range(len(label))) - {i for piece in kept.values() for i in piece}
    while loose:
        new = {}
        for i in loose:
            way = {label[j]: distance(table[i], centre[label[j]], tau) for j in beside[i] if j not in loose}
            if way:
                new[i] = nearest(way)
        for i, k in new.items():
            label[i] = k
        loose -= set(new)
    return label
