"""One kind of evaluation is a task; `TASKS` has them by name, and `ms.evaluate` runs them.

A task is a frozen record: its fields are its options. It says which items of a dataset are to be done, does one of
them, and makes tables and figures of all results. To add one, put a module into `evaluation/tasks`, or name a class by
an entry point of the group `millisight.tasks` in a package of your own.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Any, ClassVar

from millisight.core import Registry, late, make_folder, put, record, write_text
from millisight.core.errors import InputError
from millisight.evaluation._sources import EvaluationData
from millisight.evaluation._tables import Table


@record
class EvaluationItem:
    """A unit of work, done in one process; its failure does not stop others.

    Attributes
    ----------
    name : in messages
    source : what `Task.run` needs; it can be pickled
    parts : by the name of its cache file, what each result follows from beside the files; what JSON can hold
    paths : files that the results follow from
    """

    name: str
    source: Any
    parts: Mapping[str, Mapping[str, Any]]
    paths: tuple[Path, ...]


@record
class EvaluationSet:
    """The work of a task on a dataset.

    Attributes
    ----------
    items : EvaluationItem
    data : what the data are, in words, for titles; "" where that is known only from results
    failures : (name, reason) of what cannot be done
    notes : what else is to be said
    context : of the task, for its tables and figures
    """

    items: tuple[EvaluationItem, ...]
    data: str = ""
    failures: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()
    context: Any = None


@record
class ReportFigure:
    """A figure of a report, drawn when it is needed.

    Attributes
    ----------
    name : of its file, without suffix
    heading, caption : on the page
    plot : function that draws it, or the name of one in `millisight.viz`
    arguments : of the function, by name
    facts : shown as a table below the caption
    suffixes : of its files; the page shows the first
    dpi : pixels per inch, for PNG
    """

    name: str
    heading: str
    caption: str
    plot: str | Callable[..., Any]
    arguments: Mapping[str, Any] = field(default_factory=dict[str, Any])
    facts: Mapping[str, object] = field(default_factory=dict[str, object])
    suffixes: tuple[str, ...] = (".png",)
    dpi: float = 110

    def draw(self) -> Any:
        """The `matplotlib.figure.Figure`."""
        plot = late("millisight.viz", self.plot) if isinstance(self.plot, str) else self.plot
        return plot(**self.arguments)


class Task(ABC):
    """One kind of evaluation. Subclasses are records; their fields are the options."""

    __slots__ = ()
    name: ClassVar[str]
    """In `TASKS`; `<name>.md` holds its tables."""
    title: ClassVar[str]
    """Of the page."""
    cache: ClassVar[str]
    """Folder of partial results, in the output folder."""
    datasets: ClassVar[tuple[str, ...]] = ()
    """Options that are datasets too; `ms.evaluate` opens them."""

    @abstractmethod
    def plan(self, data: EvaluationData) -> EvaluationSet:
        """Plan the work; raises InputError if the options do not fit the data."""

    @staticmethod
    @abstractmethod
    def run(item: EvaluationItem) -> Mapping[str, Any]:
        """Do an item: of each of its `parts` the result, as JSON holds it."""

    @abstractmethod
    def rows(self, planned: EvaluationSet, results: Mapping[str, Any]) -> Sequence[Any]:
        """Records of all results, which come by the names of `parts`."""

    @abstractmethod
    def describe(self, planned: EvaluationSet, rows: Sequence[Any]) -> tuple[str, str]:
        """What the data are, and the introduction of the page."""

    @abstractmethod
    def tables(self, planned: EvaluationSet, rows: Sequence[Any]) -> Mapping[str, Table]:
        """By the names of their files, in the order of the page."""

    @abstractmethod
    def figures(self, planned: EvaluationSet, rows: Sequence[Any]) -> Iterable[ReportFigure]:
        """In the order of the page."""

    def write_files(self, planned: EvaluationSet, rows: Sequence[Any], folder: Path) -> None:
        """Write what else was asked for."""
        return


def _check(name: str, task: Any) -> None:
    if not (isinstance(task, type) and issubclass(task, Task)):
        raise InputError(f"task {name!r} is {task!r}; expected a subclass of millisight.evaluation.Task")


TASKS: Registry[type[Task]] = Registry("task", "millisight.tasks", package="millisight.evaluation.tasks", check=_check)


@record
class Result:
    """Result of an evaluation.

    Attributes
    ----------
    task : with its options
    planned : what was to be done
    rows : records of the task, one for each thing that was scored
    tables : by name
    failures : (name, reason) of what could not be done
    cached : number of results that an earlier run had left
    """

    task: Task
    planned: EvaluationSet
    rows: tuple[Any, ...]
    tables: Mapping[str, Table]
    failures: tuple[tuple[str, str], ...] = ()
    cached: int = 0

    def __post_init__(self) -> None:
        put(self, rows=tuple(self.rows), tables=dict(self.tables), failures=tuple(sorted(self.failures)))

    @property
    def data(self) -> str:
        """What the data are, in words."""
        return self.task.describe(self.planned, self.rows)[0]

    @property
    def summary(self) -> tuple[Table, ...]:
        """The main tables."""
        return tuple(table for table in self.tables.values() if table.place == "summary")

    @property
    def page_tables(self) -> tuple[Table, ...]:
        """All tables except those only for other programs."""
        return tuple(table for table in self.tables.values() if table.place != "file")

    def figures(self) -> Iterable[ReportFigure]:
        """The figures of the page."""
        return self.task.figures(self.planned, self.rows)

    def to_dict(self) -> dict[str, Any]:
        """Task, data, tables, failures and notes, as JSON holds them."""
        return {
            "task": self.task.name,
            "data": self.data,
            "tables": {name: table.to_dict() for name, table in self.tables.items()},
            "failures": [list(one) for one in self.failures],
            "notes": list(self.planned.notes),
        }

    def markdown(self) -> str:
        """The tables of the page."""
        return "\n\n".join(table.markdown() for table in self.page_tables) + "\n"

    def save(self, folder: Any) -> Path:
        """Write the tables as Markdown and CSV, the figures, and the page `index.html` that shows both; give its path.

        Raises
        ------
        FileError
            The folder cannot be written to.
        InputError
            There are no rows.
        """
        if not self.rows:
            raise InputError(f"the evaluation {self.task.name!r} has no result to save: {len(self.failures)} failures")
        folder = make_folder(folder)
        write_text(folder / f"{self.task.name}.md", self.markdown())
        for name, table in self.tables.items():
            write_text(folder / f"{name}.csv", table.csv())
        self.task.write_files(self.planned, self.rows, folder)
        return late("millisight.viz", "write_report")(
            folder,
            title=self.task.title,
            introduction=self.task.describe(self.planned, self.rows)[1],
            tables=self.page_tables,
            figures=self.figures(),
        )

    def _repr_html_(self) -> str:
        return "".join(table.html() for table in self.summary)
