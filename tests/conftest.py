import contextlib

from swimmer_mj.render.backend import BackendError, use_backend

# MuJoCo binds its OpenGL backend at its first import, in whichever test that is. Without a usable one, only
# the tests that draw fail, and they say what is missing.
with contextlib.suppress(BackendError):
    use_backend()
