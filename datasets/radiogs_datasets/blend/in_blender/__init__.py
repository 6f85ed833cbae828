"""The code that runs inside Blender, perhaps under another Python; it imports only ``bpy`` and the standard library."""
