"""Tables in Markdown."""


def ordered(rows: list[dict], key: str) -> list:
    """What occurs under a key: numbers by size, names as they come."""
    found = list(dict.fromkeys(r[key] for r in rows))
    return sorted(found) if all(isinstance(x, int) for x in found) else found


def rate(per_second: float) -> str:
    """A rate in words."""
    for size, name in ((1e9, "billion"), (1e6, "million")):
        if per_second >= size:
            return f"{per_second / size:.3g} {name}"
    return f"{per_second:,.0f}"


def table(heads: list[str], lines: list[list[str]]) -> str:
    """A table in Markdown, without the columns that would stay empty."""
    kept = [i for i in range(len(heads)) if any(line[i] for line in lines)]
    rows = [heads, ["---"] * len(heads), *lines]
    return "\n".join("| " + " | ".join(row[i] for i in kept) + " |" for row in rows)
