"""Settings of the JupyterLab that `python -m labkit` starts; labconfig/ has those of its pages.

There, the mark "kernel busy" stands in the bar at the bottom instead of the notebook's toolbar,
and the page's icon does not show it: a slider makes the kernel busy twenty times a second, and at
each change of its toolbar Lab lays out the page anew (a tenth of the time of a picture).
"""

import zmq
from jupyter_server.services.kernels.websocket import KernelWebsocketHandler

c = get_config()  # type: ignore[name-defined]  # noqa: F821  (Jupyter hands it in)

# Nothing is fetched from the network (labconfig/page_config.json turns off a question about news).
c.LabApp.news_url = None
c.LabApp.check_for_updates_class = "jupyterlab.NeverCheckForUpdate"
c.LabApp.extension_manager = "readonly"

# Others who use the same computer cannot read along (and the kernel does not warn that they could).
if zmq.has("curve"):
    c.KernelManager.transport_encryption = "auto"

# Many small messages go to and fro while a slider moves: send each at once (Nagle's algorithm
# would hold them back).
_open = KernelWebsocketHandler.open


async def _open_without_delay(self, *arguments, **options):
    self.set_nodelay(True)
    await _open(self, *arguments, **options)


KernelWebsocketHandler.open = _open_without_delay
