"""Print the table of planted mistakes: python -m tests.support.targets."""

from tests.support.targets.exported import IMPOSSIBLE, LOSSLESS, carrier, conformance
from tests.support.targets.mistakes import MISTAKES


def main() -> None:
    """Print per target the model, what the right export shows, and the mistakes that show."""
    print("| target | model | right export | mistakes shown | not shown |")
    print("| --- | --- | --- | --- | --- |")
    for target, row in conformance().items():
        noticed = [name for name in MISTAKES if row[name]]
        none = IMPOSSIBLE.get(target, ())
        missed = [name for name in MISTAKES if name not in noticed and name not in none]
        rest = ", ".join(missed + [f"{name}: has no place there" for name in none])
        right = ", ".join(row["none"]) or ("equal" if LOSSLESS[target] else "loss as printed")
        count = f"{len(noticed)} of {len(MISTAKES) - len(none)}"
        print(f"| {target} | {carrier(target)} | {right} | {count} | {rest} |")


if __name__ == "__main__":
    main()
