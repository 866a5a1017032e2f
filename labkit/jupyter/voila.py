"""Settings of the Voilà that `python -m labkit show` starts."""

from voila.exporter import VoilaMarkdownRenderer

from labkit.notebooks import FILTERS
from labkit.page import Formulas

c = get_config()  # type: ignore[name-defined]  # noqa: F821  (Jupyter hands it in)


class Renderer(Formulas, VoilaMarkdownRenderer):
    """Formulas as MathML, pictures of Markdown in the page."""


def give_cookie(handler, notebook, cwd):
    """A page asks for the end of its kernel when it is closed; without this cookie it gets 403."""
    handler.xsrf_token  # noqa: B018  (reading it sets the cookie)


# Voilà's own filter for Markdown finds pictures in the notebook's folder.
c.VoilaExporter.filters = {name: FILTERS[name] for name in FILTERS if name != "markdown2html"}
c.VoilaExporter.markdown_renderer_class = Renderer
c.VoilaConfiguration.prelaunch_hook = give_cookie

# The cells after one that failed are run and shown as well, as in the notebook.
c.VoilaExecutor.allow_errors = True

# A page that went without a word (a crash, a lost network) leaves a kernel behind: it ends as well.
c.MappingKernelManager.cull_idle_timeout = 600
c.MappingKernelManager.cull_interval = 60
