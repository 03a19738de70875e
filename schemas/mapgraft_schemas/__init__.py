"""What mapgraft writes, as data: message texts, table schemas, the schema of the configuration, a viewer layout.

``VERSION`` follows semantic versioning over everything here: a new optional column or field raises the minor number, a
removed, renamed or re-interpreted one the major number.
"""

from mapgraft_schemas.documents import config_schema, viewer_layout
from mapgraft_schemas.messages import MESSAGE_PACKAGE, message_texts
from mapgraft_schemas.tables import TABLES, VERSION, Column, Table, arrow_schema, table

__all__ = [
    "MESSAGE_PACKAGE",
    "TABLES",
    "VERSION",
    "Column",
    "Table",
    "arrow_schema",
    "config_schema",
    "message_texts",
    "table",
    "viewer_layout",
]
