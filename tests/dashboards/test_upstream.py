"""What is remembered of Bokeh's models is what Bokeh would say."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace

import panel as pn
import panel_material_ui as pmui
import pytest
from bokeh.core.properties import String
from bokeh.core.property.descriptors import PropertyDescriptor
from bokeh.core.property.wrappers import PropertyValueContainer
from bokeh.document import Document
from bokeh.events import Event
from bokeh.model.util import visit_value_and_its_immediate_references
from bokeh.models import Line, Model, Range1d
from bokeh.models.annotations import Title
from bokeh.server.session import ServerSession
from bokeh.server.views.ws import WSHandler
from bokeh.themes import Theme
from bokeh.util import callback_manager
from panel.io.state import set_curdoc
from panel.links import Callback

from dashboards.upstream import server
from dashboards.upstream.server import end_left_pages, leave_out_hooks, models_version, speed_up
from lab.views.figures import TimeAxis, time_figure

WHOLE_PAGE = """
import sys
from dashboards.upstream.server import speed_up
if sys.argv[1] != "plain":
    speed_up()
from bokeh.core.json_encoder import serialize_json
from bokeh.document import Document
from bokeh.themes import Theme
from panel.io.state import set_curdoc
from dashboards.page import SimulatorPage
document = Document()
with set_curdoc(document):
    page = SimulatorPage()
    page.pages.draw(), page._add_settings(), page._add_files()
    document.add_root(page._frame().get_root(document))
document.to_json()  # what is remembered of the first page is said of the second
print(serialize_json(document.to_json(deferred=False)))
"""


@pytest.fixture(autouse=True)
def fast() -> None:
    speed_up()


def test_each_default_is_that_of_bokeh() -> None:
    models: list[Model] = [time_figure("a", TimeAxis()), time_figure("b", TimeAxis(), logarithmic=True)]
    asked = 0
    for model in (one for fig in models for one in fig.references()):
        for name in model.properties():
            descriptor = model.lookup(name)
            if isinstance(descriptor, PropertyDescriptor) and not descriptor.has_unstable_default(model):
                expected = descriptor.property.themed_default(type(model), name, None)
                assert repr(descriptor.instance_default(model)) == repr(expected), (model, name)
                asked += 1
    assert asked > 1000


def test_a_theme_still_sets_defaults() -> None:
    line, plain = Line(), Line()
    assert plain.line_width == 1
    line.apply_theme({"line_width": 7})
    assert (line.line_width, plain.line_width) == (7, 1)
    line.unapply_theme()
    assert line.line_width == 1


@pytest.mark.parametrize(
    ("name", "good", "bad"), [("line_join", "round", "zigzag"), ("syncable", True, 1), ("tags", [], 1)]
)
def test_a_value_is_refused_though_one_was_accepted_before(name: str, good: object, bad: object) -> None:
    for _ in range(2):
        assert getattr(Line(**{name: good}), name) == good
        with pytest.raises(ValueError, match=name):
            Line(**{name: bad})


def test_a_value_that_changes_is_not_kept() -> None:
    """A title is another text with each step of a slider; only what models begin with is known again."""
    checked: list[str] = []

    class Noting(String):
        def validate(self, value: object, detail: bool = True) -> None:
            checked.append(str(value))
            super().validate(value, detail)

    class Titled(Model):
        text = Noting()

    for _ in range(2):
        title = Titled(text="begun")
        title.text = "later"
    assert (checked.count("begun"), checked.count("later")) == (1, 2)


def test_models_share_no_list() -> None:
    one, other = Range1d(), Range1d()
    one.tags.append("seen")
    assert other.tags == []


def test_an_empty_default_is_made_anew_as_bokeh_makes_it() -> None:
    fig = time_figure("a", TimeAxis())
    asked = 0
    for model in fig.references():
        for name in model.properties():
            descriptor = model.lookup(name)
            if isinstance(descriptor, PropertyDescriptor) and descriptor.has_unstable_default(model):
                expected = descriptor.property.themed_default(type(model), name, None)
                if isinstance(expected, PropertyValueContainer):
                    made, again = (descriptor.instance_default(model) for _ in range(2))
                    assert (type(made), made) == (type(expected), expected), (model, name)
                    assert made is not again
                    asked += 1
    assert asked > 100


def test_models_are_found_and_sent_as_bokeh_does_it() -> None:
    fig = time_figure("a", TimeAxis())
    waiting: list[Model] = [fig]
    found: set[Model] = set()
    while waiting:
        model = waiting.pop()
        if model not in found:
            found.add(model)
            for name in model.properties_with_refs():
                visit_value_and_its_immediate_references(getattr(model, name), waiting.append)
    assert fig.references() == found
    for model in found:
        every = model.properties_with_values()
        sent = model.properties_with_values(include_defaults=False)
        own = {name for name in every if name in model._property_values}
        assert own <= set(sent)
        assert list(sent) == [name for name in every if name in sent]
        assert all(sent[name] is every[name] or sent[name] == every[name] for name in sent)


@pytest.mark.proof
def test_a_whole_page_is_sent_as_it_is_without() -> None:
    """But for names: Bokeh numbers models, Panel draws one at random, and names callbacks by their place."""
    sent = []
    for way in ("fast", "plain"):
        command = [sys.executable, "-c", WHOLE_PAGE, way]
        asked = subprocess.run(
            command, env={**os.environ, "PYTHONHASHSEED": "0"}, capture_output=True, text=True, check=True
        )
        sent.append(
            re.sub(r'Notification[0-9a-f]{32}|p\d{4,}|(?<="tags":\[\[)\d+', "", asked.stdout.splitlines()[-1])
        )
    assert len(sent[0]) > 100_000
    assert sent[0] == sent[1]


def test_a_component_has_the_properties_of_before_and_copies_no_declaration() -> None:
    button = pmui.Button(label="Go", icon="add", description="Does it")
    box = pn.Column(button)
    model = button.get_root()
    assert (model.data.label, model.data.icon, model.data.disabled) == ("Go", "add", False)
    assert len(button._param__private.params) < len(list(button.param)) / 2
    assert box.get_root().children[0].data.label == "Go"
    button.param.label.label = "Own"
    assert pmui.Button.param.label.label != "Own"


def test_a_component_copies_no_declaration_of_the_values_it_is_given() -> None:
    button = pmui.Button(label="Go", icon="add", size="small", variant="outlined", margin=3)
    assert not {"label", "icon", "size", "margin"} & button._param__private.params.keys()
    assert button.param.label.allow_refs


def test_a_component_still_follows_a_widget() -> None:
    leader = pmui.TextInput(value="before")
    follower = pmui.TextInput(value=leader)
    leader.value = "after"
    assert follower.value == "after"
    assert leader in Callback.registry  # it also follows in the browser


def test_a_page_without_hooks_still_has_its_links() -> None:
    leader, follower = pmui.TextInput(), pmui.TextInput()
    leader.jslink(follower, value="value")
    page = pn.Column(leader, follower)
    leave_out_hooks(page)
    root = page.get_root()
    linked = [one for one in root.select({"type": Model}) if one.js_property_callbacks]
    assert linked


def test_an_event_just_after_a_changed_value_holds_the_lock_of_its_document() -> None:
    document, box, button = Document(), pmui.TextInput(), pmui.Button()
    document._session_context = lambda: SimpleNamespace(session=None, server_context=None)  # type: ignore[assignment]
    with set_curdoc(document):
        button.get_root(document)
        box.get_root(document)
        box._server_change(document, "box", None, "value", "", "typed")
        button._server_event(document, Event())
    waiting = [one.callback for one in document.session_callbacks]
    assert len(waiting) == 2
    assert not any(getattr(callback, "nolock", False) for callback in waiting)


def test_a_figure_on_a_page_has_the_theme_of_the_page_also_when_it_is_shown_again() -> None:
    fig, document = time_figure("a", TimeAxis()), Document()
    document.theme = Theme(json={"attrs": {"Title": {"text_color": "#123456"}}})
    usual = fig.title.text_color
    for _ in range(2):
        document.add_root(pn.Column(pn.pane.Bokeh(fig)).get_root(document))
        assert (fig.document, fig.title.text_color) == (document, "#123456")
        document.clear()
        assert (fig.document, fig.title.text_color) == (None, usual)


def test_a_themed_model_is_sent_as_bokeh_does_it() -> None:
    title, as_set = Title(text="a"), {"text_color": "#123456", "tags": []}
    title.apply_theme(as_set)
    assert title.properties_with_values(include_defaults=False) == {"text": "a", **as_set}
    title.apply_theme(dict(as_set))  # an equal copy changes nothing
    assert title.themed_values() is as_set


class Listener:
    """Methods that take as many arguments as their names say."""

    def none(self) -> None:
        """Take nothing."""

    def one(self, event: object) -> None:
        """Take an event."""

    def two(self, document: object, event: object) -> None:
        """Take a document and an event."""


def test_arguments_of_callbacks_count_as_python_counts_them() -> None:
    for listener in (Listener(), Listener()):
        for callback, expected in (
            (listener.none, 0),
            (listener.one, 1),
            (partial(listener.one, "event"), 0),
            (partial(listener.two, "document"), 1),
            (partial(listener.two, "document", "event"), 0),
            (listener.two, 2),
            (partial(listener.two, document="document"), 1),
            (lambda: None, 0),
        ):
            assert callback_manager._nargs(callback) == expected


def test_settings_of_the_server_and_of_a_page_are_found() -> None:
    one, other = Document(), Document()
    for document, css in ((one, ".a {}"), (other, ".b {}")):
        document._session_context = object
        with set_curdoc(document):
            pn.config.raw_css = [css]
    for document, css in ((one, ".a {}"), (other, ".b {}")):
        with set_curdoc(document):
            assert pn.config.raw_css == [css]
            assert pn.config.autoreload is False
    before = pn.config.nthreads
    with pn.config.set(disable_validation=True):
        assert pn.config.disable_validation
    assert not pn.config.disable_validation
    assert pn.config.nthreads == before


def test_a_document_has_another_version_with_each_model_that_it_gets_or_loses() -> None:
    document, figure = Document(), Range1d()
    versions = [models_version(document)]
    document.add_root(figure)
    versions.append(models_version(document))
    figure.start = 7.0
    assert models_version(document) == versions[-1]
    document.remove_root(figure)
    versions.append(models_version(document))
    assert versions[0] != versions[1] != versions[2]


def test_a_session_that_has_ended_is_not_asked_to_end_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its document is gone then: the server's log had an error for each page that ended sooner."""
    asked: list[Callable[[], None]] = []
    loop = SimpleNamespace(call_later=lambda after, call, *some: asked.append(partial(call, *some)))
    monkeypatch.setattr(server, "IOLoop", SimpleNamespace(current=lambda: loop))
    monkeypatch.setattr(WSHandler, "on_close", lambda handler: None)
    session = ServerSession("id", Document(), io_loop=loop)
    end_left_pages(8.0, lambda document: False)
    WSHandler.on_close(SimpleNamespace(close_code=1001, connection=SimpleNamespace(_session=session)))
    session.destroy()
    asked.pop()()
    assert not session.expiration_requested


@pytest.mark.parametrize(("code", "ends"), [(1001, True), (1006, False), (None, False)])
def test_a_session_ends_sooner_only_if_its_browser_has_left(
    code: int | None, ends: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A browser that has lost its connection says nothing, and may come back."""
    asked: list[Callable[[], None]] = []
    ended: list[str] = []
    waiting = [True, False]  # pages that open: one of them may be this one, loaded again
    loop = SimpleNamespace(call_later=lambda after, call, *some: asked.append(partial(call, *some)))
    monkeypatch.setattr(server, "IOLoop", SimpleNamespace(current=lambda: loop))
    monkeypatch.setattr(WSHandler, "on_close", lambda handler: handler.connection.detach_session())
    session = SimpleNamespace(
        request_expiration=lambda: ended.append("now"), document=Document(), destroyed=False
    )
    connection = SimpleNamespace(_session=session)
    connection.detach_session = lambda: setattr(connection, "_session", None)
    for _ in range(2):  # each page of a server asks for it
        end_left_pages(8.0, lambda document: waiting.pop(0))
    WSHandler.on_close(SimpleNamespace(close_code=code, connection=connection))
    WSHandler.on_close(SimpleNamespace(close_code=code, connection=connection))  # one without a session
    for still_there in ([], ["now"]) if ends else ():
        assert len(asked) == 1
        asked.pop()()
        assert ended == still_there
    assert not asked
