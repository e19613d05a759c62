// The time of an access is exact within a slice: 20 instructions, and a read that takes 4 cycles on the bridge.
// slots: 0 25
  systick 0xFFFFFF, 5
  ldr r0, =0xE000E018
  ldr r1, [r0]
  .rept 20
  nop
  .endr
  ldr r2, [r0]
  subs r1, r2
  keep r1, 0
  wait_forever
