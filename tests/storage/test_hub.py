"""The head of a page on the Hugging Face Hub."""

from __future__ import annotations

import pytest
import yaml

from latentmotion.storage.provenance import front_matter, license_fields


@pytest.mark.parametrize(
    ("terms", "fields"),
    [
        (["CC BY-SA 3.0 Unported"], {"license": "cc-by-sa-3.0"}),
        (["CC-BY-4.0"], {"license": "cc-by-4.0"}),
        (["Apache 2.0", "Apache 2.0"], {"license": "apache-2.0"}),
        (["CC0"], {"license": "cc0-1.0"}),
        (["MIT License"], {"license": "mit"}),
        ([], {"license": "other", "license_name": "unknown"}),
        (["MIT", "my own"], {"license": "other", "license_name": "MIT; my own"}),
        (["CC BY-SA 3.0 and more"], {"license": "other", "license_name": "CC BY-SA 3.0 and more"}),
    ],
)
def test_licenses_by_the_names_of_the_hub(terms: list[str], fields: dict[str, str]) -> None:
    assert license_fields(terms) == fields


def test_the_head_is_yaml() -> None:
    fields = {"tags": ["a", "b: c"], "none": None, "name": 'é "#', "n": [{"value": 0.5}]}
    first, text, rest = front_matter(fields).split("---\n")
    assert (first, rest) == ("", "")
    assert yaml.safe_load(text) == {key: value for key, value in fields.items() if value}
