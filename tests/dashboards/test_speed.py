"""What is remembered of Bokeh's models is what Bokeh would say."""

from __future__ import annotations

import pytest
from bokeh.core.property.descriptors import PropertyDescriptor
from bokeh.models import Line, Model, Range1d

from dashboards.speed import speed_up
from lab.views.figures import TimeAxis, time_figure


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


def test_models_share_no_list() -> None:
    one, other = Range1d(), Range1d()
    one.tags.append("seen")
    assert other.tags == []
