# SPDX-License-Identifier: Apache-2.0
"""The report of an import: numbers of written items, and omitted items with reasons. Every import prints it at its end and stores it as "result" in
import.json."""

from .errors import RecordingError

COUNTS = "steps", "cameras", "photographs", "masks", "sweeps", "boxes", "objects"
NAMED = 1000  # maximum number of names stored per reason; the count is exact


def plural(count, what):
    """ "1 sweep", "2 sweeps", "1 box"."""
    return f"{count} {what[: -2 if what == 'boxes' else -1] if count == 1 else what}"


def counted(result):
    """The counts of a result as text, steps first."""
    words = {"steps": "time steps"}
    return ", ".join(plural(result[key], words.get(key, key)) for key in COUNTS if key in result)


class Account:
    """Collects omitted items by reason, in order of first occurrence."""

    def __init__(self):
        self.rows, self.sources = {}, {}

    def leave_out(self, what, why, which=(), count=None):
        """Adds omitted items: `what` in the plural ("photographs"), the reason, and their names. With `count`, `which` may list only some of the names."""
        which = [str(name) for name in which]
        count = len(which) if count is None else count
        if count:
            row = self.rows.setdefault((what, why), {"what": what, "count": 0, "why": why, "which": []})
            row["count"] += count
            row["which"] += which[: NAMED - len(row["which"])]

    def lacks(self, what, why):
        """The source contains none of these."""
        self.rows.setdefault((what, why), {"what": what, "count": 0, "why": why, "which": []})

    def contains(self, what, count, where):
        """The source contains `count` of these in the chosen time steps; reading none of them is then an error."""
        self.sources[what] = (count, where)

    def result(self, counts):
        """The "result" of import.json: the counts of written items, then the omitted ones."""
        for what, (count, where) in self.sources.items():
            if count and not counts[what]:
                reasons = [
                    f"{plural(row['count'], what)}: {row['why']}"
                    for row in self.rows.values()
                    if row["what"] == what and row["count"]
                ]
                raise RecordingError(
                    f"{where}: {plural(count, what)} in these time steps, but none could be read"
                    + "".join(f"; {reason}" for reason in reasons)
                )
        return counts | {"left_out": list(self.rows.values())}


def lines(left_out, most=10):
    """The omitted items, one line per reason."""
    for row in left_out[:most]:
        if row["count"] == 0:
            yield f"no {row['what']}: {row['why']}"
            continue
        names = row["which"]
        first = f": {names[0]}" if row["count"] == 1 and names else f", the first is {names[0]}" if names else ""
        yield f"left out: {plural(row['count'], row['what'])}{first}: {row['why']}"
    if len(left_out) > most:
        yield f"left out for {len(left_out) - most} more reasons; see import.json"
