% Ten lines to a force-velocity plot, MATLAB or Octave: the force at the end of every ramp of a recording, over its velocity.
frame = dlmread('out/recordings/rep-1_10-psi/frame.csv', ',', 1, 0);  % t_s, position_mm, force_N, ...
ramps = dlmread('out/recordings/rep-1_10-psi/ramps.csv', ',', 1, 0);  % step, t_start_s, t_end_s, ...; column 7: velocity_mm_s
force_N = zeros(size(ramps, 1), 1);
for k = 1:size(ramps, 1)
  rows = frame(frame(:, 1) >= ramps(k, 2) & frame(:, 1) < ramps(k, 3), :);
  left_mm = abs(rows(:, 2) - rows(end, 2));                           % it stands before the step ends
  force_N(k) = rows(find(left_mm < 0.01 * left_mm(1), 1), 3);
end
plot(-ramps(:, 7), force_N, 'o');
xlabel('shortening velocity (mm/s)');
ylabel('force at the end of the ramp (N)');
print('force_velocity.svg', '-dsvg');
