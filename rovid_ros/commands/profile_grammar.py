"""The grammar of thrust profiles, for a help that needs nothing else of them."""

GRAMMAR = """\
profiles: DOF=WAVES[,DOF=WAVES ...], forces in N (N m for roll, pitch, yaw)
  surge=120@0.083                sinusoid: AMPLITUDE@FREQUENCY [Hz]
  surge=120@0.083+60@0.04        waves that add up
  surge=100@0.05,yaw=20@0.08     two degrees of freedom
  surge=multisine:120@0.02-0.2x12    12 frequencies, evenly from 0.02 to 0.2 Hz,
                                 whose sum stays within 120 N (Schroeder's phases)
  surge=steps:100@20             100 and -100 in turn, each for 20 s
  surge=steps:100/50/0/-150@20   these in turn, over and over, each for 20 s
  surge=0                        no thrust
A degree of freedom that is not named gets the sinusoids of the parameter file
(simulation.DOF.forces and frequencies)."""
