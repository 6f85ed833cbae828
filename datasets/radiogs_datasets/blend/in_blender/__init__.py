"""The code that runs inside Blender (``bpy``) in its own process; it imports only ``bpy`` and the standard library.

Another Python than the project's may run it (``process``), so nothing here knows of torch or NumPy.
"""
