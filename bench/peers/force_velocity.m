% The 48 force-velocity fits of bench_fits with Octave's fminsearch (lsqnonlin is in a package that few have), from one
% start, without intervals. Usage: octave-cli force_velocity.m FOLDER; prints one JSON object.
folder = argv(){1};
file = fopen(fullfile(folder, "points.f64"));
points = reshape(fread(file, Inf, "double"), 5, []);
fclose(file);
curves = max(points(1, :)) + 1;
tic;
for i = 0:curves - 1
  p = points(:, points(1, :) == i);
  u = @(q) exp(q(2)) * p(5, :) ./ abs(p(2, :));
  model = @(q) 1 + sign(p(2, :)) .* p(5, :) ./ p(4, :) .* (1 - exp(q(1)) * expm1(-u(q)) ./ u(q));
  fminsearch(@(q) sumsq(model(q) - p(3, :)), log([0.5, 0.2]), optimset("TolX", 1e-6, "TolFun", 1e-10));
end
printf("{\"ms\": %.4g, \"curves\": %d}\n", 1e3 * toc, curves);
exit(0);
