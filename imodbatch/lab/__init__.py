"""The lab: what detectors learn from, worlds whose truth is known, and the training itself.

objects, variants, models   meshes: seventeen household objects; endless things of five classes;
                            a user's own files
houses, tabletop, analytic  worlds → datasets: a robot in rooms; a camera in the hand at tables;
                            shapes with a formula, and a simulated detector
scene, render               placed meshes and light → frames, through embree or Blender
pictures                    things pasted on backgrounds → training pictures
learning                    training pictures → a detector
commands                    simulate, synth, train
disk, mesh, masks, progress, processes: what several of them share
"""
