"""How the datasets that are made here lie on disk.

folders     a folder is written to only where nothing foreign lies in it
images      colour, and depth in millimetres
trajectory  a camera's path
manifest    what the manifests that lie beside the data have in common
record      what data were made with and how long every file is; it is written last
"""
