"""What a Jupyter server does for labkit's notebooks: an extension of the server, `labkit.jupyter`.

`python -m labkit setup` registers it in the workbook's own environment, so that it is there
however Jupyter is started; `jupyter server extension disable labkit.jupyter --sys-prefix` turns
it off. The other files of this folder are settings of the JupyterLab and the Voilà that
`python -m labkit` starts.
"""

from __future__ import annotations

import inspect
from collections.abc import Awaitable
from typing import Any

from ..notebooks import FILTERS, TEMPLATES, complete, pre_save_hook


def _jupyter_server_extension_points() -> list[dict[str, str]]:
    return [{"module": __name__}]


def _load_jupyter_server_extension(server: Any) -> None:
    """Notebooks are stripped when saved, completed when read; exported pages need no network."""
    contents = server.contents_manager
    contents.register_pre_save_hook(pre_save_hook)
    read = contents.get

    def get(*arguments: Any, **options: Any) -> Any:
        model = read(*arguments, **options)
        return _later(model) if inspect.isawaitable(model) else _completed(model)

    contents.get = get
    server.config.HTMLExporter.template_name = "labkit"
    server.config.TemplateExporter.extra_template_basedirs = [str(TEMPLATES)]
    server.config.HTMLExporter.filters = FILTERS


async def _later(model: Awaitable[dict[str, Any]]) -> dict[str, Any]:
    return _completed(await model)


def _completed(model: dict[str, Any]) -> dict[str, Any]:
    if model["type"] == "notebook" and model.get("content"):
        complete(model["content"])
    return model
