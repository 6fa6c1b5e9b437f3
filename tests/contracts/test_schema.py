import pyarrow as pa

from pentimento.contracts import copaintings, demonstrations, pushes, scenes, strokes
from pentimento.contracts.schema import IMAGE, PATH, arrow_schema, columns_markdown, type_name, vector


def test_required_columns_are_those_of_the_design() -> None:
    assert arrow_schema(strokes.CONTRACT, include_optional=False).names == [
        "session", "order", "action_id", "tool", "path", "window_m", "before", "after",
    ]  # fmt: skip
    assert arrow_schema(pushes.CONTRACT, include_optional=False).names == [
        "session", "order", "action_id", "tool", "material", "kind", "action", "window_m", "before", "after",
        "height_per_unit_m",
    ]  # fmt: skip


def test_optional_columns_can_be_chosen() -> None:
    schema = arrow_schema(strokes.CONTRACT, include_optional={"gain", "frame"})
    assert schema.names[-2:] == ["frame", "gain"] and len(schema) == 10


def test_meaning_travels_with_the_schema() -> None:
    metadata = arrow_schema(strokes.CONTRACT).field("wet_age_s").metadata
    assert metadata[b"unit"] == b"s" and b"median" in metadata[b"description"]


def test_each_column_says_what_it_is_once() -> None:
    for module in (strokes, pushes, demonstrations, scenes, copaintings):
        names = [column.name for column in module.CONTRACT.columns]
        assert len(set(names)) == len(names)
        for column in module.CONTRACT.columns:
            assert column.description
            for suffix, unit in (("_m", "m"), ("_s", "s"), ("_n", "N"), ("_px", "px")):
                if column.name.endswith(suffix) and not column.name.endswith("_m_s"):
                    assert column.unit == unit, column.name


def test_type_names_are_readable() -> None:
    assert type_name(PATH) == "list of float32[5]"
    assert type_name(vector(4)) == "float32[4]"
    assert type_name(IMAGE) == "image"
    assert type_name(pa.float64()) == "float64"


def test_markdown_has_a_line_for_each_column() -> None:
    text = columns_markdown(strokes.CONTRACT)
    assert all(f"| `{column.name}` |" in text for column in strokes.CONTRACT.columns)
