"""What a person asks for, in the words that the goal planner was taught.

A word for a kind of a taught thing becomes that thing ("a poodle" is drawn as a dog), and so do words of near
meaning, where the extra `voice` is installed. Words that only describe a thing are left out. The person is told both. A
request for anything else is refused before anything is painted.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Final

from pentimento.bundle.vocabulary import Vocabulary
from pentimento.contracts.errors import ConfigError
from pentimento.control.nearest import nearest_word
from pentimento.control.request_items import (
    Article,
    Count,
    Item,
    Link,
    Named,
    Of,
    Order,
    Other,
    Pronoun,
    nouns_by_word,
    plain_text,
    said_of,
    scan,
    singulars,
)

MAX_THINGS: Final = 4
EXAMPLES: Final = ("a cat beside a tree", "three fish", "a bird on a house")

_NUMBERS: Final = {2: "two", 3: "three", 4: "four"}
_LISTING: Final = (",", "and", "with")
_BEFORE_IT: Final = ("above", "on", "in")
"""Relations that were taught as "a tree with a bird above it"."""
_NEGATIONS: Final = frozenset({
    "aren't", "doesn't", "don't", "except", "isn't", "neither", "never", "no", "none", "nor", "not", "nothing",
    "without",
})  # fmt: skip
_FOREIGN: Final = frozenset({
    "avec", "con", "das", "dem", "den", "der", "des", "du", "een", "ein", "eine", "einem", "einen", "einer", "el",
    "et", "gli", "het", "il", "la", "las", "le", "les", "lo", "los", "mit", "os", "um", "uma", "un", "una", "und",
    "une", "uno", "y",
})  # fmt: skip
"""Small words of other languages: what they stand before is not the English word of that spelling."""
_SAID_AFTER: Final = frozenset({
    "asleep", "awake", "covered", "filled", "flies", "fly", "full", "hang", "hangs", "jumps", "lie", "lies", "looks",
    "made", "runs", "sit", "sits", "sleep", "sleeps", "stand", "stands", "swim", "swims",
})  # fmt: skip
"""What is said of a thing after its name, besides participles and adverbs."""
_DEFINITE: Final = ("the", "this", "these", "those")
_SUGGESTIONS: Final = 3
_ALIKE: Final = 0.7
"""Similarity of two spellings by `difflib`, from which on one may be meant for the other."""
_MISSPELT: Final = 0.8
"""The same, from which on one probably is the other with a mistake."""


@dataclass(frozen=True)
class Asked:
    """Things of a kind that a request names."""

    words: str
    """One of them: "a cat"."""
    number: int
    link: str | None
    """To what is named before: a relation as taught, "and", "," or "with"; None for the first."""
    is_definite: bool = False
    """The person said "the": it may stand on the canvas already."""


@dataclass(frozen=True)
class Understood:
    """A request, and what became of the person's words."""

    text: str
    """For a goal planner that was taught scenes, without the medium."""
    drawn_as: tuple[str, ...] = ()
    """Sentences such as "a poodle: drawn as a dog"."""
    left_out: tuple[str, ...] = ()
    """Words that were not understood."""
    things: tuple[Asked, ...] = ()
    """What is to be drawn; empty where the goal planner knows all words."""
    in_a_row: bool = False
    """All things stand side by side."""

    def messages(self) -> list[str]:
        """What the person must know before the painting."""
        left_out = f"not understood and left out: {', '.join(self.left_out)}"
        return [*self.drawn_as, *([left_out] if self.left_out else [])]


@dataclass(frozen=True)
class _Thing:
    """One or more things of a kind; None for "it"."""

    link: str | None
    """To what was named before."""
    noun: Named | None
    number: int
    is_counted: bool
    """The person said how many."""
    is_definite: bool = False


@dataclass(frozen=True)
class _Clause:
    """Items that name one thing, or several in a row, and the link before them."""

    link: str | None
    items: tuple[Item, ...]


def understand(words: str, vocabulary: Vocabulary | None, *, near: bool = True) -> Understood:
    """A person's request in the words of a vocabulary; without one, the goal planner knows all words.

    Args:
        near: words of near meaning stand for taught ones.

    Raises:
        ConfigError: the request names nothing that can be drawn, or more than four things; or it is empty, too long,
            or has characters that cannot be seen.
    """
    text = plain_text(words)
    if vocabulary is None:
        return Understood(text)
    nouns = nouns_by_word(vocabulary)
    items = scan(text, nouns)
    negations = [item for item in items if item.said in _NEGATIONS]
    if negations:
        raise _refusal(negations, nouns, "Say only what is to be drawn.")
    things, left_out = _things(items, nouns, near=near)
    _check_number(things)
    orders = [item.said for item in items if isinstance(item, Order)]
    drawn_as = dict.fromkeys(_sentences(things, vocabulary))
    return Understood(
        " ".join([_text(things, vocabulary), *orders]), tuple(drawn_as), tuple(dict.fromkeys(left_out)),
        _asked(things, vocabulary), bool(orders),
    )  # fmt: skip


def _things(items: Sequence[Item], nouns: Mapping[str, Named], *, near: bool) -> tuple[list[_Thing], list[str]]:
    """The things of a request and the words that were left out.

    Raises:
        ConfigError: a clause names no thing that is known.
    """
    things: list[_Thing] = []
    left_out: list[str] = []
    for clause in _clauses(items):
        if not clause.items:  # a relation at the end
            left_out += [clause.link] if clause.link not in (None, *_LISTING) else []
            continue
        core, dropped = _without_of(clause.items)
        core = _with_nearest(core, nouns) if near else core
        found, more = _named_things(core, clause.link, nouns)
        things += found
        left_out += dropped + more
    if not things:
        raise _refusal(items, nouns)
    first = things[0].link
    if first not in (None, *_LISTING):
        left_out.insert(0, str(first))
    return _without_pronouns(things, nouns), left_out


def _clauses(items: Sequence[Item]) -> Iterator[_Clause]:
    """Split at links, and at articles and counts: "a cat wearing a hat" are two things."""
    link: str | None = None
    inside: list[Item] = []
    for item in items:
        if isinstance(item, Link):
            if inside:
                yield _Clause(link, tuple(inside))
                link, inside = None, []
            link = item.link if link is None or item.link not in _LISTING or link in _LISTING else link
        elif isinstance(item, Article | Count | Pronoun) and inside and isinstance(inside[-1], Named | Other):
            yield _Clause(link, tuple(inside))
            link, inside = "and", [item]
        elif not isinstance(item, Order):
            inside.append(item)
    yield _Clause(link, tuple(inside))


def _without_of(items: Sequence[Item]) -> tuple[list[Item], list[str]]:
    """A clause without "of", and the words left out: of "a bowl of apples" the bowl, of "a bottle of milk" the milk."""
    at = next((at for at, item in enumerate(items) if isinstance(item, Of)), None)
    if at is None:
        return list(items), []
    before, after = list(items[:at]), list(items[at + 1 :])
    things = {item.noun for item in before if isinstance(item, Named)}
    if things:  # a glass of wine is a wine glass
        others = [item for item in after if isinstance(item, Named | Other)]
        return before, [item.said for item in others if isinstance(item, Other) or item.noun not in things]
    core, dropped = _without_of(after)
    counts: list[Item] = [item for item in before if isinstance(item, Count)]
    return [*counts, *core], [item.said for item in before if isinstance(item, Other)] + dropped


def _with_nearest(items: list[Item], nouns: Mapping[str, Named]) -> list[Item]:
    """A clause without a known thing, in which the words at the end are the taught noun that is nearest in meaning.

    Words that are spelt almost like a taught one stay as they are: they are mistakes, for which a person gets advice.
    """
    start = next((len(items) - at for at, item in enumerate(reversed(items)) if not isinstance(item, Other)), 0)
    unknown = [item.said for item in items[start:]]
    is_known = any(isinstance(item, Named) for item in items)
    if (
        is_known
        or not unknown
        or not all(map(_is_english, unknown))
        or any(_alike(said, nouns, _MISSPELT) for said in unknown)
    ):
        return items
    places: dict[str, tuple[int, bool]] = {}  # where a phrase begins, and whether it is plural
    for at in range(start, len(items)):
        said = said_of(items[at:])
        places.setdefault(said, (at, False))
        for singular in singulars(said):
            places.setdefault(singular, (at, True))
    taught = [word for word, noun in nouns.items() if noun.is_taught and not noun.is_plural]
    found = nearest_word(tuple(places), taught)
    if found is None:
        return items
    at, is_plural = places[found.phrase]
    return [*items[:at], Named(said_of(items[at:]), nouns[found.word].noun, is_plural, False)]


def _named_things(
    items: Sequence[Item], link: str | None, nouns: Mapping[str, Named]
) -> tuple[list[_Thing], list[str]]:
    """The things that a clause names, and the words left out.

    The last of several nouns is the thing: a lemon tree is a tree. A word directly before the nouns describes it, and
    so do participles after it: what follows them is another thing ("cat chasing mouse").
    """
    if any(isinstance(item, Pronoun) for item in items):
        return [_Thing(link, None, 0, False)], [item.said for item in items if isinstance(item, Other)]
    last = next((at for at, item in enumerate(items) if isinstance(item, Named)), None)
    if last is None:
        raise _refusal(items, nouns)
    while last + 1 < len(items) and isinstance(items[last + 1], Named):
        last += 1
    before, noun, after = items[:last], items[last], items[last + 1 :]
    assert isinstance(noun, Named)
    foreign = [item for item in before if isinstance(item, Other) and not _is_english(item.said)]
    if foreign:
        raise _refusal(foreign, nouns)
    left_out = [item.said for item in before if isinstance(item, Named | Other)]
    things = [_thing(link, before, noun)]
    describing = next((at for at, item in enumerate(after) if not _describes(item)), len(after))
    left_out += [item.said for item in after[:describing]]
    rest = after[describing:]
    if not rest:
        return things, left_out
    if not any(isinstance(item, Named) for item in rest) or (describing == 0 and isinstance(rest[0], Other)):
        raise _refusal(rest, nouns)
    others, more = _named_things(rest, "and", nouns)
    return things + others, left_out + more


def _describes(item: Item) -> bool:
    """Whether a word after a thing tells what the thing does or how: "sleeping", "perched", "quietly"."""
    said = item.said
    return isinstance(item, Other) and (
        said in _SAID_AFTER or (len(said) > 4 and said.isascii() and said.endswith(("ing", "ed", "ly")))
    )


def _is_english(said: str) -> bool:
    """Whether a word before a thing may be an English one."""
    return said.isascii() and said not in _FOREIGN


def _thing(link: str | None, before: Sequence[Item], noun: Named) -> _Thing:
    counts = [item for item in before if isinstance(item, Count)]
    is_definite = any(isinstance(item, Article) and item.said in _DEFINITE for item in before)
    if counts and not (counts[-1].is_pair and not noun.is_plural):
        return _Thing(link, noun, max(count.number for count in counts), True, is_definite)
    is_single = any(isinstance(item, Article) and item.is_singular for item in before)
    return _Thing(
        link, noun, 2 if noun.is_plural and not is_single else 1, is_single or not noun.is_plural, is_definite
    )


def _without_pronouns(things: Sequence[_Thing], nouns: Mapping[str, Named]) -> list[_Thing]:
    """Things of which "it" is named again: "a house with a tree beside it" is "a tree beside a house"."""
    found: list[_Thing] = []
    for at, thing in enumerate(things):
        if thing.noun is not None:
            found.append(thing)
            continue
        if len(found) < 2 or found[-1].link not in _LISTING or thing.link in (None, *_LISTING):
            raise _refusal([Pronoun("it")], nouns)
        if at == 2 == len(things) - 1 and thing.link in _BEFORE_IT:
            return [*found, thing]  # as it was taught
        first, second = found[-2:]
        found[-2:] = [_Thing(first.link, *_without_link(second)), _Thing(thing.link, *_without_link(first))]
    return found


def _without_link(thing: _Thing) -> tuple[Named | None, int, bool, bool]:
    return thing.noun, thing.number, thing.is_counted, thing.is_definite


def _check_number(things: Sequence[_Thing]) -> None:
    number = sum(thing.number for thing in things)
    if number > MAX_THINGS:
        raise ConfigError(
            "The request names more than four things, and a picture can have up to four; ask for fewer. "
            "Nothing was painted."
        )
    if any(thing.noun is not None and thing.number == 0 for thing in things):
        raise ConfigError("The request names zero of a thing; say only what is to be drawn. Nothing was painted.")


def _text(things: Sequence[_Thing], vocabulary: Vocabulary) -> str:
    """The request as the goal planner was taught to read it."""
    has_it = things[-1].noun is None
    parts = [_named(things[0], vocabulary)]
    for at, thing in enumerate(things[1:], 1):
        link = thing.link or "and"
        if link in _LISTING and not has_it:
            goes_on = at + 1 < len(things) and things[at + 1].link in _LISTING
            link = "," if goes_on else "and"
        parts.append(f"{'' if link == ',' else ' '}{link} {_named(thing, vocabulary)}")
    return "".join(parts)


def _asked(things: Sequence[_Thing], vocabulary: Vocabulary) -> tuple[Asked, ...]:
    """The things without "it": "a tree with a bird above it" are a bird and, above, a tree."""
    if things[-1].noun is None:
        first, second, it = things
        things = [_Thing(None, *_without_link(second)), _Thing(it.link, *_without_link(first))]
    return tuple(
        Asked(vocabulary.nouns[thing.noun.noun].one, thing.number, thing.link if at else None, thing.is_definite)
        for at, thing in enumerate(things)
        if thing.noun is not None
    )


def _named(thing: _Thing, vocabulary: Vocabulary) -> str:
    """ "a cat", "two cats", "scissors" or "it"."""
    if thing.noun is None:
        return "it"
    noun = vocabulary.nouns[thing.noun.noun]
    return noun.one if thing.number == 1 else f"{_NUMBERS[thing.number]} {noun.many}"


def _sentences(things: Iterable[_Thing], vocabulary: Vocabulary) -> Iterator[str]:
    """What is drawn otherwise than it was said."""
    for thing in things:
        if thing.noun is None or (thing.noun.is_taught and thing.is_counted):
            continue
        said = thing.noun.said
        if thing.number > 1 and thing.is_counted:
            said = f"{_NUMBERS[thing.number]} {said}"
        elif thing.number == 1 and not thing.noun.is_plural:
            said = f"{'an' if said[0] in 'aeiou' else 'a'} {said}"
        yield f"{said}: drawn as {_named(thing, vocabulary)}"


def _refusal(items: Sequence[Item], nouns: Mapping[str, Named], advice: str = "") -> ConfigError:
    """The error that says what was not understood, what can be drawn, and what may have been meant."""
    unknown = [item.said for item in items if isinstance(item, Other)]
    quoted = " ".join(unknown) or said_of(items)
    meant = dict.fromkeys(word for said in unknown for word in _alike(said, nouns))
    suggestions = " or ".join(f'"{word}"' for word in list(meant)[:_SUGGESTIONS])
    examples = ", ".join(f'"{example}"' for example in EXAMPLES[:-1])
    sentences = [
        f'"{quoted}" is not understood{f"; did you mean {suggestions}?" if suggestions else "."}',
        *([advice] if advice else []),
        f'Ask in English for up to four things, such as {examples} or "{EXAMPLES[-1]}". Nothing was painted.',
    ]
    return ConfigError(" ".join(sentences))


def _alike(said: str, nouns: Mapping[str, Named], similarity: float = _ALIKE) -> list[str]:
    """The taught noun's word that is spelt most like what was said, if any is."""
    taught = [word for word, noun in nouns.items() if noun.is_taught and not noun.is_plural]
    return get_close_matches(said, taught, 1, similarity) if len(said) > 2 else []
