"""Places in nested JSON data: paths of keys and indices."""

import copy


def places(data, path=()):
    """Yield (path, entry) for every entry, also for lists and objects."""
    if isinstance(data, (dict, list)):
        for key, entry in data.items() if isinstance(data, dict) else enumerate(data):
            yield (*path, key), entry
            yield from places(entry, (*path, key))


def leaves(data):
    """Yield (path, entry) for every text, number, boolean and null."""
    return ((path, entry) for path, entry in places(data) if not isinstance(entry, (dict, list)))


def replaced(data, path, entry):
    """Return a copy of the data with another entry at a path."""
    whole = copy.deepcopy(data)
    holder = whole
    for key in path[:-1]:
        holder = holder[key]
    holder[path[-1]] = entry
    return whole
