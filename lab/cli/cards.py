"""``ins-lab cards``: the cards of sensors, with the sources of their numbers, and new ones."""

from __future__ import annotations

from typing import Annotated, Any

from lab.cli.app import Commands, argument, group, print_json
from lab.cli.card_table import card_text, cards_text, facts
from lab.cli.new_card import NEW_EXAMPLES, new_card
from lab.cli.options import AsJson, Assumed

EXAMPLES = """\b
Examples:
  ins-lab cards
  ins-lab cards ADIS16470
  ins-lab run montreal --card ADIS16470
  ins-lab run montreal --card ADIS16470 --no-assumed
  ins-lab cards new my_imu.toml
Numbers without a source are assumed, typical of the grade, and marked; --no-assumed omits them.
White noise is the two-sided N of IEEE 952, which is 1/√2 of a one-sided noise density."""


class CardCommands(Commands):
    """The commands about cards; a name that is no command is the name of a card to show."""

    default = "show"
    """The command that is meant without one."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the arguments: without a command, they are those of the default one."""
        if not args or args[0] not in (*self.commands, *ctx.help_option_names):
            args = [self.default, *args]
        return list(super().parse_args(ctx, args))


cards = group("cards", CardCommands)


@cards.command("show", epilog=EXAMPLES)
def list_cards(
    name: Annotated[str | None, argument("[NAME]", "Card to show in full, by name or .toml file.")] = None,
    assumed: Assumed = True,
    as_json: AsJson = False,
) -> None:
    """List the cards of real sensors, or show one with its sources, assumed and missing terms."""
    from lab.sensors.cards import card  # noqa: PLC0415 - takes half a second
    from lab.sensors.cards import cards as all_cards  # noqa: PLC0415 - beside it

    if name is None:
        found = [entry if assumed else entry.without_assumed() for entry in all_cards().values()]
        if as_json:
            print_json([facts(entry) for entry in found])
        else:
            print(cards_text(found))
        return
    one = card(name, assumed=assumed)
    if as_json:
        print_json(facts(one))
    else:
        print(card_text(one))


cards.command("new", epilog=NEW_EXAMPLES)(new_card)
