; Configuration file for a delta, firmware 3.5 M665 L999
G90                                        ; absolute
M669 K3
m665 R{machine.radius} L{arms} B{machine.bed} H{height} {turned}
M666 {ends} A0.00 B0.00 ; endstops
M558 P8 C"zprobe.in" H5 F300 T9000
G31 P500 X{offset[0]} Y{offset[1]} Z{offset[2]}
G31 K1 X50 Y50 Z9
M557 R90 S20
