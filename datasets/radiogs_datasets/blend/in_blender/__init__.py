"""What runs inside Blender (``bpy``), in a process of its own: it imports nothing but ``bpy`` and Python's library.

Another Python than the project's may run it (``process``), so nothing here knows of torch or NumPy.
"""
