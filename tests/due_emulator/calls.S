// Functions that call one another, loops, and an interrupt handler: test_function_profile.py.
  movs r1, #0
  keep r1, 0
  systick 3999, 7  // each millisecond
  movs r4, #3
  b begin
begin:
  bl outer
  subs r4, #1
  bne begin
  movs r7, #9
  bl loop
  store 0xE000E010, 0
  wait_forever
outer:
  push {r5, lr}
  bl inner
  bl leaf
  pop {r5, pc}
inner:
  push {r5, lr}
  bl leaf
  pop {r5, pc}
loop:
  subs r7, #1
  bne loop
  bx lr
leaf:
__aeabi_leaf:
  subs r6, r0, r0
  ldr r0, =1000
1: subs r0, #1
  itt eq
  moveq r6, #2
  moveq.w r6, #3
  bne 1b
  bx lr
  count_ticks
