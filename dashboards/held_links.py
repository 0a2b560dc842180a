"""Held links: held results as settings, in an address or a settings file, computed anew when that is opened.

Each one is the query of its settings, as that of an address. Results whose settings are hidden, and those of
an algorithm of one's own, are left out: settings alone do not give them again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from functools import partial
from urllib.parse import parse_qsl, unquote_plus, urlencode

from bokeh.document import Document

from dashboards.computing import LONG, LatestWins, Outcome, run
from dashboards.holding import LONGEST_NAME, describe_differences, is_renamed, name_held
from dashboards.notes import MOST_FIELDS
from dashboards.openings import Openings
from dashboards.query import HELD, experiment_of_query, query
from dashboards.sending import soon
from dashboards.session import MOST_HELD, Held, Session
from lab.base.progress import Progress
from lab.experiment.experiment import Experiment
from lab.missions import missions

SETTLED, CROWDED = 200, 1000
"""Time that a result is shown before the held ones are computed, and the same while pages open [ms]."""
NAME = "name"
"""What names a held result in its query, if a person has named it."""
MARK = "# held: "
"""What a line of a settings file with a held result begins with; for all other readers it is a comment."""
_PLAIN = "[],.:"
"""What needs no code within a field of an address."""


class HeldLinks:
    """The held results of a page as settings; those of a link are computed once its own result is shown.

    Parameters
    ----------
    session
        The session.
    document
        Its document.
    """

    def __init__(self, session: Session, document: Document) -> None:
        self._session, self._document = session, document
        self._waiting: deque[tuple[Experiment, str]] = deque()
        self._due = False
        self._openings = Openings.of(document)
        self._work: LatestWins[Experiment] = LatestWins(self._run, self._deliver, LONG)
        session.param.watch(lambda _event: self._shown(), "result")

    @property
    def texts(self) -> list[str]:
        """The settings of the held results, and of those that are still to be computed, each as a query."""
        told = [
            (one.result.experiment, one.name)
            for one in self._session.held
            if not (one.result.experiment.hidden or one.result.algorithm)
        ]
        return [_text(*one) for one in (*told, *self._waiting)]

    @property
    def query(self) -> str:
        """The held results as fields of an address."""
        return urlencode([(HELD, text) for text in self.texts], safe=_PLAIN)

    @property
    def lines(self) -> str:
        """The held results as lines of a settings file."""
        return "".join(f"{MARK}{text}\n" for text in self.texts)

    def take_link(self, link: str, longest: int) -> list[str]:
        """Hold the results in the query of a link; return what is not accepted of them, in sentences."""
        try:
            fields = parse_qsl(link, keep_blank_values=True, max_num_fields=MOST_FIELDS)
        except ValueError:  # `experiment_of_query` reports it
            return []
        texts = [text for name, text in fields if name == HELD]
        if sum(map(len, texts)) > longest:
            return [f"The held results of the link are longer than {longest} characters. They were ignored."]
        return self._take(texts)

    def take_file(self, content: str) -> list[str]:
        """Hold the results in a settings file; return what is not accepted of them, in sentences."""
        lines = content.splitlines()
        return self._take([line.removeprefix(MARK).strip() for line in lines if line.startswith(MARK)])

    def close(self) -> None:
        """Compute no more."""
        self._waiting.clear()
        self._work.close()

    def _take(self, texts: Sequence[str]) -> list[str]:
        problems, known = list[str](), set(self.texts)
        for text in dict.fromkeys(texts):
            if text in known:
                continue
            if len(self._session.held) + len(self._waiting) >= MOST_HELD:
                problems.append(f"{MOST_HELD} results can be held. The others were ignored.")
                break
            name, rest = _name_in(text)
            experiment, wrong = experiment_of_query(rest)
            if experiment.mission not in missions():
                problems.append(
                    f"A held result is of the mission {experiment.mission[:60]!r}, which is not here. "
                    "It was ignored."
                )
                continue
            problems += [f"A held result in the link: {sentence}" for sentence in wrong[:1]]
            if wrong and not query(experiment):  # nothing is left of it: nobody held the default settings
                continue
            self._waiting.append(
                (experiment, name or describe_differences(experiment, self._session.shows_sigmas))
            )
        self._shown()
        return problems

    def _shown(self) -> None:
        """Begin soon after a result is there: its plots are drawn in this turn."""
        if self._waiting and not self._due and self._session.result is not None:
            self._due = True
            self._document.add_timeout_callback(self._begin, SETTLED)

    def _begin(self) -> None:
        if self._openings is not None and self._openings.busy:
            self._document.add_timeout_callback(self._begin, CROWDED)
            return
        self._due = False
        if self._waiting:
            self._work.submit(self._waiting[0][0])

    def _run(self, experiment: Experiment, progress: Progress) -> Outcome:
        return run(experiment, progress)

    def _deliver(self, experiment: Experiment, outcome: Outcome) -> None:
        soon(self._document, partial(self._arrive, experiment, outcome))

    def _arrive(self, experiment: Experiment, outcome: Outcome) -> None:
        if not self._waiting or self._waiting[0][0] is not experiment:
            return
        _, name = self._waiting.popleft()
        if outcome.result is None:
            self._session.problem = f"A held result could not be computed again. {outcome.problem}"
        elif outcome.result.is_long:
            self._session.problem = "A result of so long a flight cannot be held."
        elif len(self._session.held) < MOST_HELD:
            held = (*self._session.held, Held(name, outcome.result))
            self._session.held = name_held(held, self._session.shows_sigmas)
        self._begin()


def _text(experiment: Experiment, name: str) -> str:
    """Return the settings of a held result as a query, with the name that a person gave it."""
    parts = [query(experiment)]
    if is_renamed(experiment, name):
        parts.append(urlencode({NAME: name}))
    return "&".join(filter(None, parts))


def _name_in(text: str) -> tuple[str, str]:
    """Return the name in the query of a held result, empty without one, and the rest of the query."""
    fields = text.split("&")
    names = [field for field in fields if field.startswith(f"{NAME}=")]
    rest = "&".join(field for field in fields if not field.startswith(f"{NAME}="))
    name = unquote_plus(names[-1].removeprefix(f"{NAME}=")) if names else ""
    return " ".join(name.split())[:LONGEST_NAME], rest
