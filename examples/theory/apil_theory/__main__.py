"""Print the table of docs/theory.md: ``python -m examples.theory.apil_theory`` in a checkout."""

from .survey import survey

if __name__ == "__main__":
    print("| bound | game | draws | violations | median gap / bound | largest |")
    print("|---|---|---|---|---|---|")
    for row in survey():
        name = f"{row.bound} | {row.game} | {row.draws} | {row.violations}"
        print(f"| {name} | {row.median:.4f} | {row.largest:.4f} |")
