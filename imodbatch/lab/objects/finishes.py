"""How the materials shine."""

from imodbatch.lab.mesh import Surface

PLUSH = Surface(specular=0.02, shininess=5)
FOAM = Surface(specular=0.08, shininess=10)
WOOD = Surface(specular=0.08, shininess=15)
PAINTED_WOOD = Surface(specular=0.2, shininess=30)
PLASTIC = Surface(specular=0.35, shininess=50)
GLAZE = Surface(specular=0.5, shininess=90)
STEEL = Surface(specular=0.8, shininess=60)
LABEL = Surface(specular=0.4, shininess=40)
GLASS = Surface(specular=0.9, shininess=200)
"""Glass, and the eyes of dolls."""
