"""A table as a figure.

The segmentation table of the paper, the only results on this page from real measurements. `millisight evaluate` also
makes a `Table`, which can be drawn in the same way, or written as Markdown, CSV or HTML.
"""

from millisight.evaluation import Table
from millisight.viz import plot_table

table = Table(
    title="Segmentation, median over the MITO dataset [%]",
    columns=("input", "LOS precision", "recall", "F1", "NLOS precision", "recall", "F1"),
    rows=(
        ("camera", 99.7, 99.5, 99.4, 3.6, 100.0, 7.0),
        ("24 GHz", 57.9, 50.1, 37.3, 53.0, 38.7, 29.1),
        ("77 GHz", 98.2, 56.4, 71.4, 95.4, 57.7, 70.2),
        ("multi-spectral", 97.1, 62.6, 74.4, 95.1, 63.1, 70.8),
    ),
    notes=(
        "Dodds, Boroushaki, Ham, Adib, ICCV 2025, Table 2. Behind cardboard the camera's mask covers the cardboard.",
    ),
)
figure = plot_table(table).figure
