"""Settings list: every setting with its unit, default, accepted values and meaning, from its declaration."""

from __future__ import annotations

import sys
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import lab
from lab.base.aid_table import AIDS
from lab.base.parameters.setting_kinds import describe, value_text
from lab.experiment.experiment import Experiment

LAB = Path(lab.__file__).parent


class SettingsList(SphinxDirective):
    """``.. settings-list:: GROUP`` lists the settings of a group, such as ``sensors.gyro``."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the list."""
        group = self.arguments[0]
        for module in list(sys.modules.values()):  # the declarations stand in many of them
            if (file := getattr(module, "__file__", None)) and Path(file).is_relative_to(LAB):
                self.env.note_dependency(file)
        whole = "" if group == "experiment" else f"{group}."
        items = nodes.definition_list()
        for path, owner, name in Experiment().leaves():
            if path.rpartition(".")[0] != whole.rstrip("."):
                continue
            declaration = owner.param[name]
            default = value_text(declaration, declaration.default)
            term = nodes.term(
                "", "", nodes.literal(text=path), ids=[path.replace(".", "-").replace("_", "-")]
            )
            facts = f"Default {default}; accepted is {describe(declaration)}."
            about = nodes.definition("", nodes.paragraph(text=facts))
            if declaration.doc:
                about += nodes.paragraph(text=declaration.doc)
            items += nodes.definition_list_item("", term, about)
        if not len(items):
            raise self.error(f"settings-list: there is no group {group!r}")
        return [items]


class SensorLists(SphinxDirective):
    """``.. sensor-lists::`` has a section with the settings of each sensor of the aid table."""

    def run(self) -> list[nodes.Node]:
        """Return the sections."""
        sections = (
            f"{aid.title}\n{'-' * len(aid.title)}\n\n.. settings-list:: sensors.{aid.name}" for aid in AIDS
        )
        return self.parse_text_to_nodes("\n\n".join(sections), allow_section_headings=True)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives."""
    app.add_directive("settings-list", SettingsList)
    app.add_directive("sensor-lists", SensorLists)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
