"""What all tables of a study file are: strict types, and no key that is not known."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, model_validator
from pydantic.fields import FieldInfo

from glvis.common.complaints import shortened
from glvis.problem.expressions import nearest


class Table(BaseModel):
    """A table of the study file: strict types, no unknown key."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)

    @classmethod
    def fields_by_key(cls) -> dict[str, FieldInfo]:
        """Return the fields by their keys, as the file spells them."""
        return {field.alias or name: field for name, field in cls.model_fields.items()}

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Any) -> Any:
        if isinstance(data, dict):
            known = cls.fields_by_key()
            for key in data:
                if key not in known:
                    hint = nearest(key, known) or "; known are " + ", ".join(known)
                    raise ValueError(f"unknown key '{shortened(str(key))}'{hint}")
        return data

    def given(self) -> dict[str, Any]:
        """Return what the file says, by key and without the defaults."""
        return {
            key: getattr(self, name)
            for key, name in zip(self.fields_by_key(), type(self).model_fields, strict=True)
            if name in self.model_fields_set
        }
