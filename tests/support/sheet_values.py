"""Values of the rows of a sheet, from the data of its report."""


def values(data, *groups):
    """Return name -> value of the rows in some groups, by default in all."""
    return {
        name: row["value"]
        for name, row in data["sheet"].items()
        if not groups or row["group"] in groups
    }
