"""The browser page: MuJoCo, value networks and their swimmers in one HTML file that works from disk.

:func:`~swimmer_mj.render.page.policies.describe` says of a policy what the page has to know;
:func:`~swimmer_mj.render.page.assemble.write_page` puts it together with the sources in ``source/`` (plain ES modules)
and MuJoCo's own WebAssembly build in ``mujoco/`` (Apache-2.0; brought by tools/mujoco_wasm.py).
"""
