% Ten lines to a force-velocity plot, MATLAB or Octave: the force at the end of every move of a recording, over its velocity.
frame = dlmread('out/recordings/rep-1_10-psi/frame.csv', ',', 1, 0);  % t_s, position_mm, force_N
t = (frame(1, 1):0.01:frame(end, 1))';                                % s, even
rate_mm_s = gradient(interp1(frame(:, 1), frame(:, 2), t), 0.01);
force_N = interp1(frame(:, 1), frame(:, 3), t);
change = diff([0; abs(rate_mm_s) > 0.3; 0]);                          % mm/s: above what noise makes of 10 ms
first = find(change == 1);
last = find(change == -1) - 1;
velocity_mm_s = arrayfun(@(a, b) median(rate_mm_s(a:b)), first, last);
plot(-velocity_mm_s, force_N(last), 'o');
xlabel('shortening velocity (mm/s)');
ylabel('force at the end of the move (N)');
print('force_velocity.svg', '-dsvg');
