"""Pictures of the swimmer: video, film strip, learning curves.

Nothing is imported here. :mod:`~swimmer_mj.render.strip` and :mod:`~swimmer_mj.render.curves` draw with
matplotlib alone; :mod:`~swimmer_mj.render.video` draws with MuJoCo, for which
:mod:`~swimmer_mj.render.backend` chooses an OpenGL backend.
"""
